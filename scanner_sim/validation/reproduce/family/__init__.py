"""The ledger of published facts: what is printed of the instruments, beside what the simulator says of them."""
