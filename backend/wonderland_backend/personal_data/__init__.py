"""What is kept about one drone and its operator, or about one account: all of it to give, part of it to erase."""
