"""The published method: *Shape Modeling of A String And Recognition Using Distance Sensor*."""
