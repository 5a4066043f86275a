# SPDX-License-Identifier: Apache-2.0
"""A hook of mkdocs: links that lead out of docs/ lead to the file in the repository, as they do when read there."""

import posixpath
import re

LINK = re.compile(r"\]\((?P<path>\.\./[^)#\s]+)(?P<anchor>#[^)\s]+)?\)")


def on_page_markdown(markdown, page, config, **_):
    folder = posixpath.dirname(page.file.src_uri)

    def lead_out(match):
        path = posixpath.normpath(posixpath.join("docs", folder, match["path"]))
        if path.startswith("docs/"):
            return match[0]
        return f"]({config.repo_url}/blob/main/{path}{match['anchor'] or ''})"

    return LINK.sub(lead_out, markdown)
