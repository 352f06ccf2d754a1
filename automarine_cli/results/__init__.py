"""What result files hold, for whoever reads them back: one record a kind of file, and the kinds themselves."""
