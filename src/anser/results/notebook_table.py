"""Results as a table in a notebook."""

from collections.abc import Mapping, Sequence
from html import escape


def notebook_table(title: str, rows: Sequence[Mapping[str, str]], notes: Sequence[str] = ()) -> str:
    """Write HTML of a table with a title above and notes below.

    Parameters
    ----------
    title, notes
        Plain text.
    rows
        Cells by the name of their column, all with the same columns; plain text.
    """
    heads = "".join(f"<th>{escape(name)}</th>" for name in (rows[0] if rows else ()))
    lines = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row.values())}</tr>" for row in rows)
    table = f"<table><thead><tr>{heads}</tr></thead><tbody>{lines}</tbody></table>" if rows else ""
    return f"<div><p><b>{escape(title)}</b></p>{table}{''.join(f'<p>{escape(one)}</p>' for one in notes)}</div>"
