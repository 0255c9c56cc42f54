"""Work on many frames by one interface, ``map_frames``, whichever engine runs them."""
