"""What makes the server a good neighbour: addresses, encryption, logs, a quick end, and being found."""
