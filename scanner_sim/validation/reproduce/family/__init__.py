"""The ledger of published facts: what is printed of the family's instruments, beside what the simulator says of them."""
