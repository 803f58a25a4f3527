"""The pictures of each kind of result, by the names of their files."""
