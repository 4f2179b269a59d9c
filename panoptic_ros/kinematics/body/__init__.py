"""One body over time: measurements become targets, and solved poses update lengths and noise levels."""
