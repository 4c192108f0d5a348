"""The client library of the vibroimpact computation service."""
