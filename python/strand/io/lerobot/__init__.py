"""Read LeRobot data sets of version 3, and write them with the ropes of each frame; without LeRobot."""
