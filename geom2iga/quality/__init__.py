"""What can be proven of a patch."""
