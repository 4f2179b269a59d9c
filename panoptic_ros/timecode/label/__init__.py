"""Turn words into consecutive labels, frame rates and user bits, and separate certain from likely ones."""
