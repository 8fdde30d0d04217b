"""How a hand is moved: kinematics, commands of operators, decisions of reinforced policies."""
