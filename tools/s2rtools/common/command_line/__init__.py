"""What the commands of `s2r` share: arguments that name a store, output of rows, progress."""
