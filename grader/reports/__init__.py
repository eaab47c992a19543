"""Views of results: none of them changes a grade."""
