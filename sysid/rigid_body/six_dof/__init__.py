"""The rigid body whose attitude and rates are states: from rotor speeds or commands to the whole motion."""
