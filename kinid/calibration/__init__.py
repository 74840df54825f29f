"""What a rig states of its own instruments, estimated from logs."""
