"""From a notebook to a program: the entry point and what it needs, found by reading the notebook, not by running it."""

import ast
import itertools
import json
import re
import symtable
import warnings
from typing import NamedTuple

# Line magics, shell escapes and help requests, alone on a line or assigned.
_MAGIC = re.compile(r"^([ \t]*)(?:[%!?].*|\w[\w, .]*=[ \t]*[%!].*|[\w.]+\?{1,2}[ \t]*)$", re.MULTILINE)
# Cell magics whose cell is still Python that binds names here.
_TRANSPARENT = re.compile(r"%%(time|capture|prun)\b")
_BINDS = re.compile(r"^(?:(?:async[ \t]+)?def|class)[ \t]+(\w+)|^(\w+)[ \t]*=", re.MULTILINE)
_MUTATORS = {"add", "append", "extend", "insert", "setdefault", "update"}


class _Statement(NamedTuple):
    """A top-level statement: the names it binds or changes, those it needs to run and, of functions, to be called."""

    cell: int
    node: ast.stmt
    text: str
    binds: frozenset
    needs: frozenset


def extract(content, entry_point, size_limit):
    """Source of the statements that a notebook's entry point depends on.

    Kept, in order, are the top-level imports, definitions and assignments that bind a name which the entry point
    uses, itself or through what it uses. Dropped is the rest: magics, plots, experiments, imports of the grader, and
    rebindings through its `check`, so that what is graded is the student's own function.

    Parameters
    ----------
    content : bytes
        The .ipynb file.
    entry_point : str
        The name a submission must define; when no cell does, the source is of no use but the caller sees it.
    size_limit : int
        Most characters the code cells may have together.

    Returns
    -------
    str
        Python source; a comment names the code cell that follows.

    Raises
    ------
    ValueError
        Not a notebook of format 4, or no code in it, or too much.
    SyntaxError
        In a cell that the entry point needs; its message names the cell.
    RecursionError, MemoryError
        Some expression is nested too deeply for the compiler.
    """
    cells = [_without_magics(text) for text in code_cells(content, size_limit)]
    statements, broken = [], []
    for number, cell in enumerate(cells, start=1):
        try:
            statements += _statements(cell, number)
        except SyntaxError as error:
            broken.append((number, cell, error))
    kept, needed = _closure(statements, entry_point)
    for number, cell, error in broken:
        if needed & {name for pair in _BINDS.findall(cell) for name in pair}:
            raise SyntaxError(f"{error.msg} in code cell {number}", (None, error.lineno, error.offset, error.text))
    # A __future__ import is only allowed at the start of a file.
    kept.sort(key=lambda statement: not _is_future(statement.node))
    lines = []
    for cell, group in itertools.groupby(kept, key=lambda statement: statement.cell):
        lines += [f"# code cell {cell}", *(statement.text for statement in group)]
    return "".join(f"{line}\n" for line in lines)


def code_cells(content, size_limit):
    """Text of a notebook's code cells; parameters as in `extract`.

    Raises
    ------
    ValueError
        Not JSON, not a notebook, an old format, or no code in it, or too much.
    """
    try:
        data = json.loads(content)
    except ValueError:
        raise ValueError("is not a notebook (not JSON): save it again from JupyterLab") from None
    if not isinstance(data, dict) or not isinstance(data.get("nbformat"), int):
        raise ValueError("is not a notebook (no nbformat): save it again from JupyterLab")
    if data["nbformat"] < 4:
        raise ValueError(f"has the old notebook format {data['nbformat']}: open it in JupyterLab and save it again")
    cells = data.get("cells")
    cells = [cell for cell in cells if isinstance(cell, dict)] if isinstance(cells, list) else []
    code = [_text(cell.get("source")) for cell in cells if cell.get("cell_type") == "code"]
    if not any(text.strip() for text in code):
        raise ValueError("has no code cells: hand in the notebook you worked in")
    if sum(map(len, code)) > size_limit:
        raise ValueError(f"its code cells hold more than {size_limit // 1_000_000} MB: hand in code without data")
    return code


def bound_names(node):
    """Names a top-level statement binds, also inside `if`, `try`, `for` and `with`, but not inside functions."""
    names, stack = set(), [node]
    while stack:
        node = stack.pop()
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            names.add(node.name)
            continue
        if isinstance(node, ast.Lambda | ast.ListComp | ast.SetComp | ast.DictComp | ast.GeneratorExp):
            continue
        if isinstance(node, ast.Import | ast.ImportFrom):
            names.update((alias.asname or alias.name).partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.add(node.id)
        elif isinstance(node, ast.Attribute | ast.Subscript) and isinstance(node.ctx, ast.Store):
            names.update(_base(node))
        elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
            called = node.value.func
            if isinstance(called, ast.Attribute) and called.attr in _MUTATORS:
                names.update(_base(called))
        stack.extend(ast.iter_child_nodes(node))
    return frozenset(names)


def _base(node):
    """The name whose object `a.b[c].d` belongs to."""
    while isinstance(node, ast.Attribute | ast.Subscript):
        node = node.value
    return [node.id] if isinstance(node, ast.Name) else []


def _needed_names(text):
    """Global names that running a statement, or calling what it defines, looks up."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        module = symtable.symtable(text, "cell", "exec")
    names = {symbol.get_name() for symbol in module.get_symbols() if symbol.is_referenced()}
    tables = module.get_children()
    while tables:
        table = tables.pop()
        # A class body that assigns a name may still read the global of that name first.
        in_class = table.get_type() == "class"
        names |= {s.get_name() for s in table.get_symbols() if s.is_global() or (in_class and s.is_referenced())}
        tables += table.get_children()
    return frozenset(names)


def _statements(cell, number):
    """The top-level statements of one code cell."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            tree = ast.parse(cell)
        except ValueError as error:
            # Null bytes and lone surrogates.
            raise SyntaxError(str(error)) from None
    # The compiler counts columns in bytes.
    lines = [line.encode() for line in cell.split("\n")]
    statements = []
    for node in tree.body:
        first = min([node.lineno] + [d.lineno for d in getattr(node, "decorator_list", [])])
        piece = lines[first - 1 : node.end_lineno]
        begin = node.col_offset if first == node.lineno else 0
        if len(piece) == 1:
            piece[0] = piece[0][begin : node.end_col_offset]
        else:
            piece[0], piece[-1] = piece[0][begin:], piece[-1][: node.end_col_offset]
        text = b"\n".join(piece).decode()
        statements.append(_Statement(number, node, text, bound_names(node), _needed_names(text)))
    return statements


def _closure(statements, entry_point):
    """Statements on which the entry point depends, in order, and the names it depends on."""
    checks = {"check"}.union(*(s.binds for s in statements if _is_grader_import(s.node)))
    binders = {}
    kept = set()
    for i, statement in enumerate(statements):
        if _is_grader_import(statement.node) or _is_check(statement.node, checks):
            continue
        if _is_future(statement.node) or "*" in statement.binds:
            kept.add(i)
        for name in statement.binds:
            binders.setdefault(name, []).append(i)
    needed, waiting, followed = {entry_point}, [entry_point], set()
    while waiting:
        for i in binders.get(waiting.pop(), []):
            if i not in followed:
                followed.add(i)
                waiting += statements[i].needs - needed
                needed |= statements[i].needs
    kept |= followed
    return [statements[i] for i in sorted(kept)], needed


def _is_future(node):
    return isinstance(node, ast.ImportFrom) and node.module == "__future__"


def _is_grader_import(node):
    """Whether a statement imports from the grader and nothing else."""
    if isinstance(node, ast.ImportFrom):
        return (node.module or "").partition(".")[0] == "grader"
    return isinstance(node, ast.Import) and all(a.name.partition(".")[0] == "grader" for a in node.names)


def _is_check(node, checks):
    """Whether a statement assigns what a check returned: the student's function, or a stand-in for it."""
    value = node.value if isinstance(node, ast.Assign | ast.AnnAssign) else None
    if not isinstance(value, ast.Call):
        return False
    called = value.func
    return (isinstance(called, ast.Name) and called.id in checks) or (
        isinstance(called, ast.Attribute) and called.attr == "check" and set(_base(called)) <= checks
    )


def _text(source):
    """A cell's source, which the format allows to be a string or a list of strings."""
    if isinstance(source, list):
        source = "".join(line for line in source if isinstance(line, str))
    return source.replace("\r\n", "\n").replace("\r", "\n") if isinstance(source, str) else ""


def _without_magics(cell):
    """A cell in which the lines that are IPython's and not Python's do nothing."""
    if cell.lstrip().startswith("%%"):
        first, _, rest = cell.lstrip().partition("\n")
        cell = "\n" + rest if _TRANSPARENT.match(first) else ""
    if not any(mark in cell for mark in "%!?"):
        return cell
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            ast.parse(cell)
        return cell
    except (SyntaxError, ValueError):
        return _MAGIC.sub(r"\1pass", cell)
