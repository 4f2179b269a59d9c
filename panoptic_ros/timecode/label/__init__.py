"""Words to labels that count on, to rates and user bits: what is sure, and what only seems so."""
