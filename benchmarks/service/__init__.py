"""The service: answers over HTTP, jobs, memory and idling, and another checkout beside it."""
