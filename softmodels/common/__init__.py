"""What every room and every package shares: units, errors, schemas, files, folders, commands and processes."""
