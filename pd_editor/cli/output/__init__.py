"""What commands print: progress, tables, outcomes and errors."""
