"""Recordings of ROS 2 as data sets: bag folders, MCAP and SQLite files, through the package rosbags."""
