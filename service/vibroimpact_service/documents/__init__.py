"""What arrives: from bytes to checked documents, problems of the solvers and their names."""
