"""Files of other programs: readers and writers, found by the type of a value and imported by name."""
