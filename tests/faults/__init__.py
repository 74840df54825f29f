"""What a machine does to a program: a kill, a full disk, a clock that is set back."""
