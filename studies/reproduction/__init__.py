"""What the papers that are done again share: claims, chapters in processes, figures, one page."""
