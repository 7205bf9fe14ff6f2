"""Files in and out: hand files, recordings, exports."""
