"""What dxb puts on the search path of every program: the program's side of the protocol."""
