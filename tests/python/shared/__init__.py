"""What tests share: ropes, files, recordings, calls, a browser."""
