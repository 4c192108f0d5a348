"""Other programs on the same motions: their runs, a judge of their errors, and who is faster."""
