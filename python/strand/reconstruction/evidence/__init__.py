"""What speaks for and against an answer: what cameras saw, colours, what is known beforehand."""
