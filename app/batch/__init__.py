"""Many recordings become things: one after the other, some at once, on one machine or on several."""
