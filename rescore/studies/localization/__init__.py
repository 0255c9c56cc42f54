"""The study of section 5.1 of the report: model cars on a table, placed, segmented, localised, scored."""
