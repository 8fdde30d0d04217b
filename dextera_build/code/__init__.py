"""The code of rules: how it is found, digested into keys, and run by workers."""
