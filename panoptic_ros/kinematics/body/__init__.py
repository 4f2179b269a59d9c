"""One body, instant by instant: what is known of it becomes targets, poses become what is learnt of it."""
