"""What was measured with what: the rig, the log, and the formats that logs come in."""
