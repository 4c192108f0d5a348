"""The migrations of keys and administrative acts."""
