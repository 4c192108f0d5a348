"""Result classes of all computations: each field declared once, free of kernels to import."""
