"""A page that stands alone: Markdown and figures of result folders in one HTML file."""
