"""The robot of section 5.2: an arm with a hand that grasps what was localised on the table, in simulation."""
