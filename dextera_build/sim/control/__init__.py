"""Moving a hand: kinematics, commands of operators, actions of reinforcement-learned policies."""
