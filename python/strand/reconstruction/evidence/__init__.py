"""Evidence for and against an answer: the cameras' rays, colours, and the caller's knowledge."""
