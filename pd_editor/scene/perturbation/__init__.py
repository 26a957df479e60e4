"""Road warps (Scene-Attack) of whole scenarios, and their friction limit."""
