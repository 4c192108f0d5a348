"""Authentication and authorisation: keys, tokens, scopes, rate limits and quotas."""
