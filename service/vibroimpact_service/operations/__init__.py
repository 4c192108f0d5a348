"""What operators do beside a service: migrate its records, check it, back it up, restore it."""
