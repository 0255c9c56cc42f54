"""Pictures of single objects, on tables and in rooms, that studies measure on."""
