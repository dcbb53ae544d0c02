"""Tables, figures and HTML reports for readers."""
