"""``inkjet explore``: the local web application. State is kept in classes without widgets; the views only draw it."""
