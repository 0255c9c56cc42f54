"""What the tests read of a page."""

from html.parser import HTMLParser

LOADING = {"src", "href", "srcset", "data", "action", "poster"}


class Page(HTMLParser):
    """Attributes, table cells, scripts and plain text of a page."""

    def __init__(self, text: str):
        super().__init__()
        self.links: list[str] = []
        self.missing_alt = 0
        self.ids: list[str] = []
        self.tables: dict[str, list[list[str]]] = {}
        self.scripts: list[tuple[dict[str, str | None], str]] = []
        self.cards: list[dict[str, str | None]] = []
        self.text = ""
        self._table, self._tag, self._cell = "", "", False
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        self.links += [v or "" for k, v in attrs if k in LOADING]
        self.missing_alt += tag == "img" and not attributes.get("alt")
        self.ids += [attributes["id"]] if "id" in attributes else []
        self._tag = tag
        if "card" in (attributes.get("class") or "").split():
            self.cards.append(attributes)
        if tag == "table":
            self._table = attributes["id"] or ""
            self.tables[self._table] = []
        if tag == "tr":
            self.tables[self._table].append([])
        if tag in ("td", "th"):
            self.tables[self._table][-1].append("")
            self._cell = True
        if tag == "script":
            self.scripts.append((attributes, ""))

    def handle_endtag(self, tag):
        self._tag = ""
        if tag in ("td", "th"):
            self._cell = False

    def handle_data(self, data):
        if self._cell:
            self.tables[self._table][-1][-1] += data
        if self._tag == "script":
            attributes, text = self.scripts[-1]
            self.scripts[-1] = (attributes, text + data)
        elif self._tag != "style":
            self.text += data
