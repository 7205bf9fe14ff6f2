"""Commands of `hand_tracker`, one module each; `hand_tracker COMMAND --help` lists options."""
