"""The fast path of regular frames, from middleware to middleware in compiled code."""
