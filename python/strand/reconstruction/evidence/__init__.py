"""What speaks for and against an answer: the cameras' rays, colours, and what the caller knows."""
