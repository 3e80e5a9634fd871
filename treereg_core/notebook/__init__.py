"""How a result shows itself in a notebook: plots and a card of HTML."""
