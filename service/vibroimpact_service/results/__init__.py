"""What leaves: results as stored containers and as the representations that are sent."""
