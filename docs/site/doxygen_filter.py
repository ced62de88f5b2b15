#!/usr/bin/env python3
"""doxygen_filter.py HEADER: what Doxygen reads of a header.

In our headers a comment is for all declarations below it up to a blank line or the next comment; Doxygen takes it for the
first one alone, so the others get it, too. Members that every class of a kind has mean the same in each and have no comment;
their text is here. The inline namespace of the ABI and the marks of what is exported are left out: users never write them. Lines keep their numbers.
"""
import re
import sys

SAME_EVERYWHERE = [(re.compile(pattern), text) for pattern, text in [
    (r'#define ASTERISM_STRING', 'Its argument as a string literal.'),
    (r'using Scalar = ', 'Type of coordinates, stiffness and energies: float or double.'),
    (r'using Point = ', 'One point, Dim x 1.'),
    (r'using Points = ', 'Points, Dim x N: a node is a column.'),
    (r'using System = ', 'The spring systems that it is for.'),
    (r'using TopologyType = ', 'Who is linked to whom.'),
    (r'using (Matrix|Vector) = ', 'Its matrices and vectors.'),
    (r'using Springs =$', 'Its spring systems.'),
    (r'static constexpr int kDim = ', 'Number of coordinates of a point.'),
    (r'static constexpr int kNodes = ', 'Number of nodes, or Eigen::Dynamic.'),
    (r'static constexpr int kMaxNodes = ', 'Greatest number of nodes, or Eigen::Dynamic.'),
    (r'static constexpr std::string_view (kName|kIdaName) = ', 'Its part in the name of a solver that has it.'),
    (r'static constexpr std::string_view name\(\)', 'Its name, as Summary::solver gives it.'),
    (r'\w*Options(<.*>)? options;', 'Used by the next solve.'),
    (r'(\w+Options|CellFeatures|KcfFeatures|Kernel) \w+( = \{.*\})?;', 'Options of their own; see their type.'),
    (r'constexpr const char\* problem\(\) const', 'What is wrong with it, a null pointer for nothing.'),
    (r'const \w+Options& options\(\) const', 'The options that it was made with.'),
    (r'int nodes\(\) const', 'Number of nodes.'),
    (r'int link_count\(\) const', 'Number of links.'),
    (r'std::span<const Link> links\(\) const', 'Links in the order in which their values are kept.'),
    (r'const TopologyType& topology\(\) const', 'Who is linked to whom.'),
    (r'constexpr \w+Options\(const \w+Options& options\)', 'The same values, the rest by default.'),
    (r'void init\(const (cv::Mat& image|Frame& frame), const cv::Rect2d& box\)',
     'Starts on the object in `box` [px]; see Tracker.'),
    (r'TrackResult update\(const (cv::Mat& image|Frame& frame)\)', 'Where the object is in the next image; see Tracker.'),
    (r'void init\(const Frame& frame, const Point2& centre, const Size2& size\)', 'See PartModel.'),
    (r'Evidence localize\(', 'See PartModel.'),
    (r'double similarity_at\(', 'See PartModel.'),
    (r'void adapt\(const Frame& frame, const Point2& at\)', 'See PartModel.'),
    (r'void visit_state\(StateArchive& archive\)', 'Shows an archive all that it has learned; see StateArchive.'),
    (r'(inline )?void visit_options\(OptionVisitor& visit, ', 'Shows a visitor each option with its name.'),
    (r'(inline |friend )*std::ostream& operator<<\(', 'Writes it as text.'),
    (r'constexpr std::string_view to_string\(', 'Its value in words.'),
]]


# Doxygen ends a brief at a full stop before a space, unless a backslash is between them.
ABBREVIATION = r'(///.*?\b(?:Secs?|Eqs?|Figs?|Alg|al|cf|e\.g|i\.e|vs)\.)'


def keep_briefs(header):
    header = re.sub(ABBREVIATION + r'\n( */// )(\S+) ?', r'\1 \3\n\2', header)  # not at the end of a line
    count = 1
    while count:
        header, count = re.subn(ABBREVIATION + ' ', r'\1\\ ', header)
    return header


TWO_FIELDS = re.compile(r'(\s*)((?:static constexpr )?\w+) (\w+ = [^,;(]+), (\w+ = [^,;(]+);(.*)')


def mark_file(header):
    """Doxygen lists a header if a comment is for the file. The comment right after `#pragma once` is, if a blank line follows."""
    said = re.match(r'#pragma once\n\n((?:///.*\n)+)\n', header)
    if not said:
        return header.replace('#pragma once\n\n', '#pragma once\n/** \\file */\n', 1)
    lines = said[1].replace('///', '')
    return f'#pragma once\n/** \\file\n{lines}*/\n' + header[said.end():]


def main():
    header = open(sys.argv[1], encoding='utf-8').read()
    header = re.sub(r'^(inline namespace ASTERISM_ABI \{|\}  // namespace ASTERISM_ABI)$', '', header, flags=re.MULTILINE)
    lines = mark_file(keep_briefs(header)).replace(' ASTERISM_API ', ' ').split('\n')
    comment, indent, used = [], 0, False  # the last comment, and whether a declaration has taken it
    for number, line in enumerate(lines):
        text = line.lstrip()
        if text.startswith('///'):
            if used:
                comment = []
            comment.append(text[3:].strip())
            indent, used = len(line) - len(text), False
            continue
        if not text or text.startswith('//') or text.endswith(':'):
            comment, used = [], False
            continue
        if re.match(r'(struct|class) .*\{$', text):
            comment, used = [], False
            continue
        if comment and (len(line) - len(text) != indent or text[0] in '{}:'):
            continue  # inside of what the comment is for
        if TWO_FIELDS.match(line) and (comment or '///<' in line):
            said = line[line.index('///<') + 4:] if '///<' in line else ' '.join(comment)
            lines[number] = TWO_FIELDS.sub(rf'\1\2 \3; /** {said} */ \2 \4;\5', line)
        if '///<' in line:
            comment, used = [], False
            continue
        if comment and not used:
            used = not text.startswith(('template', 'requires'))
            continue
        said = next((words for pattern, words in SAME_EVERYWHERE if pattern.match(text)), ' '.join(comment))
        if said:
            lines[number] = '/** ' + said + ' */ ' + lines[number]
    sys.stdout.write('\n'.join(lines))


main()
