"""The documents exchanged over HTTP: systems, requests, plans, jobs, problems, results."""
