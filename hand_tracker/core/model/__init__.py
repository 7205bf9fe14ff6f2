"""The model of the hand: joints, markers, states, kinematics, capsules."""
