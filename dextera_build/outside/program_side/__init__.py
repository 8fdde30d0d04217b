"""The search path of every program: the program's side of the protocol."""
