"""An index of scenes by what happens in them, and its queries."""
