"""What every artifact is made of: fields, their stored form, identity, files; and tables."""
