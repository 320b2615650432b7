"""What is written and read: EXR, tables, folders that are replaced as a whole."""
