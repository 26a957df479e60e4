"""The library: a collection of edited scenarios for a joint export."""
