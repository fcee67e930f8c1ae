"""The audit of a building: a report on the floor where a scanner cannot localize the robot."""
