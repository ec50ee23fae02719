"""The leaderboard as a page that needs no server, as tables of the terminal and as files."""
