"""The shell: one module per subcommand."""
