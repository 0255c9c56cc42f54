"""What measured disparity says in and around a box, as numbers a candidate; nothing here judges them."""
