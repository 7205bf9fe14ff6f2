"""The commands: a file for each, `hand_tracker COMMAND --help` tells of its options."""
