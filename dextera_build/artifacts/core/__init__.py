"""Parts of every artifact: fields, their stored form, identity, files."""
