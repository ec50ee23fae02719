"""Study of an env: the cost of detection and tracking, where and how often identities err, and the gain of hypotheses.

`plan` lists the runs, `runs` makes or reads them and holds their scores; `rows` makes the tables, `figures` the
figures, `relations` compares with the paper, and `page` shows all of it.
"""
