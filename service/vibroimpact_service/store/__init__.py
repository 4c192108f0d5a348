"""Results and chunks by content, in a folder or an object store."""
