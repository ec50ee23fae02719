"""The leaderboard as a page without a server, tables of the terminal, and files."""
