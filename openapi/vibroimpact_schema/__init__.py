"""The documents that cross the wire: systems, requests, plans, jobs, problems, results."""
