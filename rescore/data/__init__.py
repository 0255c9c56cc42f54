"""What is known of a frame before anything looks at it: pictures, measured depth, camera, boxes, splits."""
