"""The library: kept scenarios in a folder."""
