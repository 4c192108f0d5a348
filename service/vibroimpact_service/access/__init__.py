"""Who may ask for what, and for how much: keys, tokens, scopes, rates and quotas."""
