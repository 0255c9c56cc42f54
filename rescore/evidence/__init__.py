"""What measured depth says of a candidate: eq. 6 of the report, and the modes that go past it."""
