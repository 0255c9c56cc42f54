"""Work on very many frames in parts: each is written once, found again, and none is done twice."""
