"""What a reconstruction did, in numbers, lines of text and pictures."""
