"""Where shots come from on a live bench: cameras, controller boards, and the bench that owns both."""
