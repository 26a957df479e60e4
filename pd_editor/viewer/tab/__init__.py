"""What every element of a browser tab shares."""
