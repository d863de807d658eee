"""The page: a Zenoh consumer that shows the air picture in a browser; ``docs/web.md`` says what and how."""
