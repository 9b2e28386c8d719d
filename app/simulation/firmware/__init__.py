"""Controller boards as programs: the bytes they send, the steps they make, and when."""
