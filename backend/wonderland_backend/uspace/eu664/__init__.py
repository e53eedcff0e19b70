"""Network identification and traffic information by EU 2021/664, articles 8 and 11: which fields, to whom, how soon."""
