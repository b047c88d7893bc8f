"""What a run leaves behind: fields, rows, files, and the words that go with them."""
