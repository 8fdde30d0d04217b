"""The live session: an operator's hands move the robot of a task in real time, seen in the browser or a headset."""
